"""Parts of networks that training saves and evaluation rebuilds."""
