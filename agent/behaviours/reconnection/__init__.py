"""Finding each other again: beliefs of where the others are, and paths likely to meet them."""
