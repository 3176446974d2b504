"""Coverage control on top of state estimates (Julian et al. 2009, sec. 4 and Fig. 3)."""
