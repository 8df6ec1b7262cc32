"""Segmentation of pictures into patches of one colour."""
