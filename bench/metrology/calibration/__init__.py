"""Calibrations of units: conversion of an output to the measured quantity."""
