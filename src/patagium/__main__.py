"""The command line as `python -m patagium`."""

from patagium.cli.main import run

if __name__ == "__main__":
    run()
