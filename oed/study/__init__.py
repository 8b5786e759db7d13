"""The whole path from a study file to its results, stage by stage; finished stages are stored."""
