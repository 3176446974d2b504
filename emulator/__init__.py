"""The broker's side: scenarios, the world, virtual time, fleets and the command line."""
