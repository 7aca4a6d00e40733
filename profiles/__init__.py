if __name__ == "profiles":  # a second copy, from a checkout on the path
    raise ImportError("profiles is srl.profiles now: `import srl.profiles`", name="profiles")
