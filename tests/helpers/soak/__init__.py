"""Long trials: processes killed, disks full, floods, failing cameras, captures without an end. `make soak`."""
