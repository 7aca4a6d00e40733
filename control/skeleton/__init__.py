"""Skeletons of human, supernumerary arms and both together (Zhang, Liu, Li, 2022): trees, kinematics, the paper's form.

One convention inside, that of BVH: a node's rotation acts after its own offset and moves its children. SI units,
quaternions w x y z; the suit's axes: y up, z forward in the T-pose, x to the body's left.
"""
