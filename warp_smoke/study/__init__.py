"""What accuracy costs in time: error against time for each method, on known answers and on a user's own stage."""
