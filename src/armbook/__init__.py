"""What only the book on the robot arm needs: drawings, peers, names and styles."""
