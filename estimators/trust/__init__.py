"""How far a fit can be trusted: one interval for each parameter, one verdict, their evidence."""
