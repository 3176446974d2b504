"""The ways a robot is connected."""
