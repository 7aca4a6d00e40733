"""The fault campaign: every profile, every device, every fault, and what the limb did."""
