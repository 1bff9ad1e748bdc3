"""Many scenes, many settings, many machines: a study file in, one folder of identical results out whatever ran it."""
