"""A study of coupled chains: simulated records, what [HBH] reads off them, and the chains."""
