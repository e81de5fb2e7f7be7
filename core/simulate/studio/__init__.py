"""The simulated studio: cameras, body, room, boards and the images that they give, with all truth."""
