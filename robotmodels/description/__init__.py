"""What a robot file says: URDF, motors, springs, which numbers are free."""
