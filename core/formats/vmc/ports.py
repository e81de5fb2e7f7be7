"""UDP ports of the VMC protocol."""

MARIONETTE_PORT = 39539  # port on which programs that display a body listen
PERFORMER_PORT = 39540  # port on which programs that process a body listen
