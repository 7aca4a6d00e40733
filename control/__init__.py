"""The control laws and what they share: mathematics, without I/O and without a clock."""

if __name__ == "control":  # a second copy, from a checkout on the path
    raise ImportError("control is srl.control now: `import srl.control`", name="control")
