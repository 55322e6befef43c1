"""Robots of tests."""

FLAPPER = """
name: flapper
gravity: 9.81 m/s^2
bodies:
  body: {floating: true, mass: 100 g, shape: {type: box, size: [20 cm, 4 cm, 4 cm]}}
  left_wing:
    parent: body
    at: [0, 3 cm, 0]
    joints:
      - {name: left_plunge, axis: x, limits: [-60 deg, 60 deg]}
      - {name: left_feather, axis: y, limits: [-60 deg, 60 deg]}
    mass: 4 g
    center_of_mass: [0, 10 cm, 0]
    shape: {type: plate, chord: 8 cm, span: 20 cm, thickness: 1 mm}
wings:
  - name: left_wing
    segments:
      - body: left_wing
        strips: 1
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -6 cm}
          - {span: 20 cm, leading: 2 cm, trailing: -6 cm}
mirror:
  - {from: left, to: right}
"""
"""Two stiff wings on a floating body, one strip each."""
