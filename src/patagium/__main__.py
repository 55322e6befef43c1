"""The command line, as the program `patagium` and as `python -m patagium`."""

import os
import signal


def main() -> None:
    """Run the program; Ctrl-C during its imports ends it silently with exit code 130."""
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours:
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(130))
    from patagium.cli.main import run

    if ours:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


if __name__ == "__main__":
    main()
