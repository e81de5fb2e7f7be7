"""The solver: from labelled markers to full-body poses."""
