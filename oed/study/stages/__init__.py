"""The stages of a study, a file each: what a stage reads, what it computes and what it stores."""
