"""What is done once with a limb or a person: calibration, jogging, a profile of one's own, and their commands."""

if __name__ == "commissioning":  # a second copy, from a checkout on the path
    raise ImportError("commissioning is srl.commissioning now: `import srl.commissioning`", name="commissioning")
