"""Contacts and pictures, in SAPIEN."""
