"""What an activation costs, measured against the floor; `python -m tests.bench`. Asserts nothing."""
