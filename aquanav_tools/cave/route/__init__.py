"""The way from entrance to goal: route, panels, narrow places and start poses."""
