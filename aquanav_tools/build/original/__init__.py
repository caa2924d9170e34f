"""Reading the original benchmark's Unity project, and placing its caves as its scenes did."""
