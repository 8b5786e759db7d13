"""Where a robot would touch itself or what stands around it."""
