"""What [HBH] section 4 prints of its case study: three chains of three masses."""

RESONANCES = (24.63, 29.59, 34.16, 44.92, 48.60, 51.28)
"""Square roots of lambda, (5), but for the rigid mode's [rad/s]."""

ANTI_RESONANCES = (
    (13.11, 25.29, 29.75, 43.62, 46.88, 49.33),
    (14.93, 27.05, 34.15, 43.13, 47.94, 51.27),
    (15.63, 27.55, 33.55, 43.38, 48.12, 51.17),
)
"""Square roots of lambda_0 of each chain, (6) [rad/s]."""

HIGH_GAINS = (1.431, 0.250, 0.143)
LOW_GAINS = (0.175, 0.067, 0.042)
CROSS_GAINS = (0.012, 0.015, 0.009)
"""A_H, A_L of each chain and A_C of chains 1 and 2, 1 and 3, 2 and 3 [1/kg]."""

FIRST_COMPONENTS = (
    (0.3569, 0.1808, 0.1292, 0.7077, 0.2070, 0.2104, 0.4850),
    (0.5248, 0.5016, 0.5723, 0.0368, 0.3019, 0.2289, 0.0218),
    (0.5538, 0.5238, 0.4761, 0.2561, 0.2881, 0.1890, 0.0894),
)
D2 = (
    (509.89, 148.67, 71.43, 185.14, -122.06, -196.46, -582.52),
    (393.60, 71.97, -71.83, -15.36, -382.91, -369.07, -40.90),
    (395.56, 56.45, -76.76, -115.94, -375.61, -311.47, -171.31),
)
SECOND_COMPONENTS = (
    (0.6033, 0.1759, 0.0845, 0.2191, -0.1444, -0.2325, -0.6892),
    (0.5867, 0.1073, -0.1071, -0.0229, -0.5708, -0.5502, -0.0610),
    (0.5920, 0.0845, -0.1149, -0.1735, -0.5622, -0.4662, -0.2564),
)
B11 = (1428.6, 750.0, 714.29)
B12 = (845.15, 670.82, 668.15)
B22 = (1500.0, 1400.0, 1375.0)
"""First Lanczos step of each chain, (13) to (16) [1/s^2]."""

PARAMETERS = {
    **{"m1": 0.7, "m2": 2.0, "m3": 3.0, "m4": 4.0, "m5": 5.0, "m6": 6.0},
    **{"m7": 7.0, "m8": 8.0, "m9": 8.9},
    **{"K1": 1000.0, "K2": 2000.0, "K3": 3000.0, "K4": 4000.0, "K5": 5000.0, "K6": 6000.0},
    **{"m3_6": 1.0, "m3_9": 2.0, "m6_9": 3.0},
}
"""Identified masses and couplings [kg] and springs [N/m]."""

ERRATA = (
    "At the end of section 3.4, θ₂ = θ₁ − τ₁/K₁ must read θ₂ = θ₁ − τ₂/K₁ with "
    "τ₂ = τ₁ + m₁ω²θ₁: the force in the spring is τ₂.",
    "A_1H is printed as 1.430 and as 1.431, read off a figure; 1/m₁ is 1.4286.",
    "The first entry of d₂ of chain 1 is printed 509.89; exactly it is 509.885.",
    "m₉ is printed 8.9, and the printed A_3L of 0.042 gives 8.8; the exact gain gives 9.",
)
"""Misprints and rounding in the paper."""
