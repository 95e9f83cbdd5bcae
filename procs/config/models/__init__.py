"""What each kind of configuration file may say."""
