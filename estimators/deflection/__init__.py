"""Springs from encoders on both sides of the gears."""
