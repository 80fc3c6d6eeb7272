from .geojson import feature_collection as feature_collection
