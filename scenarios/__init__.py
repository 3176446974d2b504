"""Experiments that come with Heliograph: what to run, how to score it."""
