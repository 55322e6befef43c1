from patagium.viewer.replay import replay as replay
from patagium.viewer.replay import still as still

__all__: list[str]
