from .tracker import LiveObject as LiveObject
from .tracker import Tracker as Tracker
