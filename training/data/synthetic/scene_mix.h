// SPDX-License-Identifier: Apache-2.0
// What synthetic scenes are mixed from: how often a scene has what, and how much of it. Shares are probabilities;
// extents hold at full motion strength.
#pragma once

namespace holdfast::mix {

constexpr double kPi = 3.141592653589793;

struct Range {
  double low, high;
};

// How far a motion goes.
struct Extent {
  double shift = 0;      // of the frame's width and height
  double angle = 0;      // radians
  double log_scale = 0;  // 0.92 is a zoom by 2.5
};

// A camera wanders to and fro; where 'travel' is not 0 it goes that far along a straight way instead.
struct CameraKind {
  double share;
  Extent wander, travel;
};
constexpr CameraKind kCameras[] = {
    {0.26, {}, {}},                       // on a stand
    {0.30, {0.08, 0.05, 0.1}, {}},        // in a steady hand
    {0.20, {0.3, 0.3, 0.4}, {}},          // carried about
    {0.09, {0.1, 0, 0.2}, {0, kPi, 0}},   // turning, as from the air
    {0.08, {0.1, 0.1, 0}, {0, 0, 0.92}},  // zooming
    {0.07, {0, 0.05, 0.1}, {0.7, 0, 0}},  // panning by most of a frame
};
constexpr CameraKind kDeepCamera = {1, {0, 0.05, 0.2}, {0.5, 0, 0}};  // shows parallax: it has to move sideways

constexpr Range kTravelled = {0.4, 1};     // of the extent of a travel
constexpr double kThereAndBack = 0.6;      // of the travels
constexpr double kRestingCamera = 0.15;    // of the cameras stand still for a stretch
constexpr double kRestingObject = 0.2;     // of the objects
constexpr Range kRestLength = {0.3, 0.8};  // of the clip

constexpr double kTremblingCamera = 0.2;   // of the cameras
constexpr double kTremble = 2.5;           // pixels a frame, at most
constexpr double kJoltedCamera = 0.07;     // of the cameras
constexpr double kJolt = 0.1;              // of the frame's smaller side, in one frame, at most
constexpr Range kJoltLength = {0.1, 0.5};  // of the clip
constexpr double kTremblingObject = 0.1;   // of the objects

constexpr double kDeepScene = 0.15;             // of the scenes: the background is a stack of layers
constexpr double kForeground = 0.4;             // of the deep scenes have a layer in front of the objects too
constexpr Range kCoverParallax = {1.1, 1.6};    // each layer's camera shift over that of the one behind it
constexpr Range kBehindCover = {0.3, 0.65};     // how much of the frame a layer behind the objects covers
constexpr Range kForegroundCover = {0.1, 0.3};  // the same in front of them

constexpr Range kObjectSide = {0.15, 0.8};  // of the frame's smaller side
constexpr Extent kObjectWander = {0.4, 1.2, 0.47};
constexpr double kTurningObject = 0.08;  // of the objects turn by up to half a turn
constexpr Extent kObjectTurn = {0, kPi, 0};
constexpr double kGrowingObject = 0.08;  // of the objects come nearer or go away, up to a factor of 2.5
constexpr Extent kObjectGrowth = {0, 0, 0.92};
constexpr double kLeavingObject = 0.08;  // of the objects leave the frame, most of them to come back
constexpr Extent kObjectLeave = {1.2, 0, 0};

constexpr double kSwarm = 0.05;             // of the scenes: many small objects that look alike
constexpr Range kSwarmSide = {0.06, 0.16};  // of the frame's smaller side
constexpr double kCamouflage = 0.26;        // of the scenes whose objects look alike: like the background too

constexpr double kCreature = 0.12;            // of the objects have limbs
constexpr Range kLimbLength = {0.3, 0.9};     // of a limb's first segment, relative to the body
constexpr Range kLimbThickness = {0.2, 0.5};  // of a segment, relative to its length
constexpr Range kSwing = {0.15, 1.1};         // radians about each joint, to either side
constexpr Range kSwingPeriod = {5, 40};       // frames

constexpr double kOccluders = 0.4;           // of the scenes
constexpr double kReturningOccluder = 0.35;  // of the occluders cross twice

constexpr double kMotionBlur = 0.12;    // of the scenes
constexpr Range kShutter = {0.2, 0.8};  // of the time between frames
constexpr double kShadows = 0.3;        // of the scenes

constexpr double kPlainObject = 0.5;  // of the objects of a plain scene are plain too

}  // namespace holdfast::mix
