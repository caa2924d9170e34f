"""What is done with photos and videos before anything is matched: read, order, judge, forecast, prepare."""
