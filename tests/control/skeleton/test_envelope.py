"""What of the wearer is inside the envelope's capsules."""

from __future__ import annotations

import numpy as np
from helpers.blame import Wearer
from hypothesis import example, given, settings
from hypothesis import strategies as st

from srl.control.skeleton.body_clearance import BodyClearanceConfig
from srl.control.skeleton.body_motion import BodyMotion
from srl.control.skeleton.capsules import nearest
from srl.runtime.contracts.rotation import from_euler_xyz, product

FINGERS = ("Index", "Middle", "Ring", "Pinky")
BENT, STRAIGHT = (85.0, 90.0, 60.0, 0.0), (0.0, 0.0, 0.0, 0.0)
INSIDE = 0.002  # m, by which every joint and tip is inside: of flesh 10 mm thick, 8 may stick out

# degrees, of the three joints and spread, as far as fingers go
finger = st.tuples(st.floats(0, 90), st.floats(0, 100), st.floats(0, 70), st.floats(-15, 15))
CONFIG = BodyClearanceConfig(least=0.02, uncertainty=0.0)
WEARER = Wearer(CONFIG, np.random.default_rng(0), 1.0)
MOTION = BodyMotion(CONFIG.figure, CONFIG.envelope.ends, 0.05)


@given(st.tuples(finger, finger, finger, finger))
@example((STRAIGHT, BENT, BENT, BENT))
@example((BENT, STRAIGHT, BENT, BENT))
@example((BENT, BENT, STRAIGHT, BENT))
@example((BENT, BENT, BENT, STRAIGHT))
@example((BENT, BENT, BENT, BENT))
@example(((0, 0, 0, 20), (0, 0, 0, 0), (0, 0, 0, -10), (0, 0, 0, -25)))
@settings(deadline=None)
def test_no_finger_sticks_out_however_they_are_bent(bent):
    tree, envelope, pose = CONFIG.figure.tree, CONFIG.envelope, WEARER.aside()
    for name, (*angles, spread) in zip(FINGERS, bent, strict=True):
        for joint, angle in enumerate(np.deg2rad(angles), 1):
            turn = from_euler_xyz(0.0, 0.0, float(angle))
            if joint == 1:
                turn = product(from_euler_xyz(0.0, float(np.deg2rad(spread)), 0.0), turn)
            pose[WEARER.names.index(f"RightHand{name}{joint}")] = turn
    nodes = MOTION.kinematics.nodes(pose, WEARER.translation, {})
    bones = [n for n in tree.names if n.startswith("RightHand") and any(f in n for f in FINGERS)]
    assert len(bones) == 16
    places = nodes[[tree.index(name) for name in bones]]
    points, out = np.stack([places, places], axis=1), np.full(len(places), np.inf)
    for (start, end), radius in zip(envelope.ends, envelope.radii, strict=True):
        each = np.arange(len(points))
        out = np.minimum(out, nearest(points, each, nodes[[start, end]], 0 * each).distance - radius)
    assert out.max() <= -INSIDE, bones[int(out.argmax())]
