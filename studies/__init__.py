"""The papers' experiments, on simulated devices or on hardware, and their evaluation."""
