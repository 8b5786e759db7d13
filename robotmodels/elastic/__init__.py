"""From a robot file to equations of motion: bodies, torsions, equilibrium, derivatives."""
