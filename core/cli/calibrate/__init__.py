"""`perfanim calibrate` and its subcommands."""
