"""The water volume of a passage and everything measured in it."""
