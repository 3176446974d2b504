"""State estimates across the team: who broadcasts whose in its slot (Julian et al. 2009)."""
