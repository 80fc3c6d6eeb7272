from .geometry import feature_collection as feature_collection
