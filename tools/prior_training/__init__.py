"""Training the learned motion prior."""
