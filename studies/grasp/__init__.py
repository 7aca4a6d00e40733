"""Studies of grasps: does an extra finger make a better one?"""
