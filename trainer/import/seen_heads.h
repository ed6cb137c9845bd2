// Heads of poses that another program found, turned to where the pictures show that they look.
#pragma once

#include "trainer/import/importer.h"

namespace doppel {

// Finds the body's person in each frame, and the face (trainer/person), and turns neck and head as
// those of a clip are: programs that fit bodies to joints hardly see which way a head is turned,
// and frames that disagree give a texture several faces. A frame in which the person is not found
// where the body is keeps the head that it has. Says in source["heads"] what was seen, and keeps
// the faces' points in capture.faces. Where the request wants heads as given, that is all. Takes
// the networks that scripts/setup --models fetches; without them, or without a device, it does
// nothing.
void takeSeenHeads(Capture& capture, const ImportRequest& request);

}  // namespace doppel
