// Which way is up where a motion's poses are.
#pragma once

#include <glm/gtc/quaternion.hpp>
#include <string>

#include "trainer/motion/motion.h"

namespace doppel {

// What turns the space of a motion's poses into one with y up. Poses from a capture are in camera
// space, y down. Poses without cameras may also have been made with y or z up: the one of the three
// that brings the bodies closest to standing; of people who mostly lie or crawl, the one whose
// ground they stay on.
glm::dquat uprightRotation(const Motion& motion);

// What the motion's reader took its file to mean, and which axis is up, in a line for people:
// "AMASS, 120 a second, z up". Empty for a capture, of which nothing is guessed.
std::string takenAs(const Motion& motion);

}  // namespace doppel
