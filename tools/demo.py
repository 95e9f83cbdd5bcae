"""x."""
def demo() -> int:
    """x

    Example: trocar demo
    """
    return 0
