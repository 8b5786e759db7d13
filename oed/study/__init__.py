"""The whole path from a study file to its results, stage by stage; what is finished is kept."""
