"""Numbers and conclusions of [WM] section 6 on an ABB IRB6600."""

REASONABLE_BY_COST = {
    "LLS15U": 0.80,
    "LLSM15U": 0.64,
    "LLS15O": 0.35,
    "NLS15U": 0.03,
    "LLS1U": 0.02,
    "NLS15O": 0.00,
}
"""Part of the models with a normalised cost below 1.5."""

REASONABLE_BY_SPRINGS = {
    "LLS15U": 0.62,
    "LLSM15U": 0.43,
    "LLS15O": 0.21,
    "NLS15U": 0.02,
    "LLS1U": 0.02,
    "NLS15O": 0.00,
}
"""Part of the models with 11 of the 12 springs between half and twice the best model's."""

ALL_SPRINGS = 0.12
"""That part for LLS15U with all 12 springs."""

TABLE_1 = {
    "k1": (0.97, 1.01, 1.05, 1.01, 0.020, 0.0069),
    "k2": (0.99, 1.02, 1.04, 1.02, 0.012, 0.0081),
    "k3": (0.061, 1.00, 3.67, 1.10, 0.66, 0.103),
    "k4": (0.72, 0.99, 1.26, 0.97, 0.13, 0.042),
    "c1": (0.84, 0.99, 1.45, 1.00, 0.12, 0.037),
    "c2": (0.24, 1.04, 1.51, 0.99, 0.30, 0.056),
    "c3": (0.16, 0.55, 7.05, 1.57, 1.93, 0.865),
    "c4": (0.048, 0.44, 34.1, 2.27, 6.14, 0.186),
}
"""Minimum, median, maximum, mean and std of the best 31 LLS15U models, and std_th of the best."""

CONCLUSIONS = (
    "the LLS estimator is superior to the NLS estimator for this type of system",
    "more than one position is needed in order to get a reasonable estimate",
    "using phase information improves the estimate",
    "rough user-defined weights work much better than the theoretically optimal weights",
    "gearbox parameters are easier to estimate than arm structure parameters",
    "spring parameters are easier to identify than damping parameters",
    "the theoretical uncertainties give a good indication of the quality of the estimated "
    "parameters",
)
"""[WM] section 7, in their order."""
