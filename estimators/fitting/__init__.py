"""Gray-box fits: residuals, weights, searches from many starts, and what stays unexplained."""
