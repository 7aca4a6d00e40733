"""The papers' experiments, on simulated devices or on hardware, and their evaluation."""

if __name__ == "studies":  # a second copy, from a checkout on the path
    raise ImportError("studies is srl.studies now: `import srl.studies`", name="studies")
