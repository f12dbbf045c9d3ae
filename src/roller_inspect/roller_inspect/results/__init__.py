"""What a run leaves behind: bag, cloud, text, report and pictures."""
