"""Caves made of formulas with known answers, and damage done to them."""
