"""Live motion exchange by the Virtual Motion Capture protocol (OSC over UDP)."""
