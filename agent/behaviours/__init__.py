"""Behaviours that come with Heliograph, one folder per algorithm family."""
