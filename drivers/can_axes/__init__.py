"""What drivers of drives on a CAN bus have in common: axes, their position after power-up, and faults by axis."""
