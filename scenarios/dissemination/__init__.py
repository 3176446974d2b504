"""State estimates across the team: studies, scores and figures (Julian et al. 2009)."""
