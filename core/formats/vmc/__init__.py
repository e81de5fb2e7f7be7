"""Motion to and from other programs, live, by the Virtual Motion Capture protocol (VMC: OSC messages over UDP)."""
