"""Many takes: tracked, solved, retargeted and told about, in parallel, going on where an earlier run stopped."""
