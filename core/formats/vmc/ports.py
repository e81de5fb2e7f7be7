"""Customary UDP ports of the protocol."""

MARIONETTE_PORT = 39539  # of a program that shows a body
PERFORMER_PORT = 39540  # of a program that receives a body
