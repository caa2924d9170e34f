"""A pool of workers, reached by pipes or through a Ray cluster; imports no other room."""
