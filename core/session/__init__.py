"""Sessions: labelling and solving of a stream of marker frames, live or recorded."""
