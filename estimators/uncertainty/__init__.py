"""How certain a fit is: Theorem 1, weak combinations, residuals, what to measure next."""
