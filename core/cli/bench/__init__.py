"""The tables and figures of the paper, measured on motion that the databases do not hold."""
