"""What every room uses: errors, arrays, guarded files, fingerprints, processes."""
