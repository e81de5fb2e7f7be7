"""People without markers: points that a neural network finds in pictures."""
