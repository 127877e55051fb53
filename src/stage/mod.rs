//! Where pictures are shown: screens in the room, the viewer's eyes, and the off-axis projection between.
