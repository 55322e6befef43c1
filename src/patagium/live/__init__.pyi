from patagium.live.autopilot import Autopilot as Autopilot
from patagium.live.autopilot import Ticks as Ticks
from patagium.live.autosave import AutoSave as AutoSave
from patagium.live.pipeline import Pipeline as Pipeline

__all__: list[str]
