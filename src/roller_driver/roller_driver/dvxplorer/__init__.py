"""Driver of the DVXplorer Mini event camera over USB; knows nothing of ROS."""
