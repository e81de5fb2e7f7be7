"""The UDP ports on which programs listen by the protocol's custom."""

MARIONETTE_PORT = 39539  # of a program that shows a body
PERFORMER_PORT = 39540  # of a program that is told about one
