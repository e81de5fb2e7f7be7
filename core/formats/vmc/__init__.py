"""Live exchange of motion through the Virtual Motion Capture protocol (OSC over UDP)."""
