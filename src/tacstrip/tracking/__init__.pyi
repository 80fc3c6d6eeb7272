from .layered import LayeredTracker as LayeredTracker
from .tracker import LiveObject as LiveObject
from .tracker import Tracker as Tracker
