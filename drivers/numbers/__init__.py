"""Devices that send plain numbers, as the profile describes them."""
