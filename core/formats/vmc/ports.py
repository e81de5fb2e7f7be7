"""UDP ports of the protocol."""

MARIONETTE_PORT = 39539  # where programs that display a body listen
PERFORMER_PORT = 39540  # where programs that process a body listen
