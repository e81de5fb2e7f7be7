"""`perfanim take` and its subcommands."""
