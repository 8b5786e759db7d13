"""What a log's numbers say of its channels: factors and lags, units, sides, signs, excitation."""
