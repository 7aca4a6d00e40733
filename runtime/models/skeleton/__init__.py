"""Motion trees (BVH), and worn arms as a part of them."""
