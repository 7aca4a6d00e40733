if __name__ == "drivers":  # a second copy, from a checkout on the path
    raise ImportError("drivers is srl.drivers now: `import srl.drivers`", name="drivers")
