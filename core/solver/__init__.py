"""From labelled markers to full-body poses."""
