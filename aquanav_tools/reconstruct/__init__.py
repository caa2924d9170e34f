"""From photos to a metric point cloud. The only room that imports pycolmap."""
