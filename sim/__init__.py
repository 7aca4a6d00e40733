if __name__ == "sim":  # a second copy, from a checkout on the path
    raise ImportError("sim is srl.sim now: `import srl.sim`", name="sim")
