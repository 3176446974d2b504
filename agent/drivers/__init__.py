"""Lamp, camera and body as a behaviour sees them."""
