"""Plant: from the amplifier's input to the tip, the part and the passive arm; pure."""
