"""Matches by geometry: motions between frames by the surfaces that their depth shows, without colour."""
