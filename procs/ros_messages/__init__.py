"""ROS 2 without ROS: its messages, their names and hashes, and a participant that ROS takes for a node."""
