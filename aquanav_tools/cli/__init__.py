"""Commands: parse arguments, call the library, print, choose the exit code."""
