// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "training/data/curve.h"

namespace holdfast {
namespace {

TEST(CurveTest, GoesThroughItsKnotsAndOnAlongItsSlope) {
  const Curve curve({1, 3, 2}, 10);
  EXPECT_DOUBLE_EQ(curve.At(0), 1);
  EXPECT_DOUBLE_EQ(curve.At(5), 3);
  EXPECT_DOUBLE_EQ(curve.At(10), 2);
  EXPECT_NEAR(curve.At(12) - curve.At(10), 2 * (curve.At(10) - curve.At(10 - 1e-6)) / 1e-6, 1e-4);
}

TEST(CurveTest, FewKnotsGiveNothingAConstantAndALine) {
  EXPECT_EQ(Curve().At(3), 0);
  EXPECT_EQ(Curve({4}, 10).At(7), 4);
  EXPECT_DOUBLE_EQ(Curve({1, 3}, 10).At(2.5), 1.5);
  EXPECT_DOUBLE_EQ(Curve({1, 3}, 10).At(-5), 0);
  EXPECT_DOUBLE_EQ(Curve({1, 3}, 10).At(20), 5);
}

TEST(CurveTest, IsSmoothAtItsKnots) {
  const Curve curve({0, 5, -3, 4}, 9);
  for (const double knot : {3.0, 6.0}) {
    const double before = (curve.At(knot) - curve.At(knot - 1e-5)) / 1e-5;
    const double after = (curve.At(knot + 1e-5) - curve.At(knot)) / 1e-5;
    EXPECT_NEAR(before, after, 1e-3);
  }
}

TEST(CurveTest, RandomKnotsStayWithinTheAmplitude) {
  Rng rng(2);
  for (int i = 0; i < 100; ++i) {
    const Curve curve = Curve::Random(rng, 4, 2, 9);
    for (const double knot : {0.0, 3.0, 6.0, 9.0}) EXPECT_LE(std::abs(curve.At(knot)), 2 + 1e-12);
  }
}

TEST(RngTest, GivesTheNumbersItAlwaysGave) {
  Rng rng(1, 2);
  // Fixed by the standard's definition of the engine: clips of a seed are the same on every machine.
  EXPECT_EQ(MixSeed(1, 2), 17911839290282890590ull);
  EXPECT_EQ(rng.Next(), 5361123582190666735ull);
}

TEST(RngTest, NormalNumbersHaveMeanZeroAndDeviationOne) {
  Rng rng(3);
  double sum = 0, squares = 0;
  constexpr int kCount = 20000;
  for (int i = 0; i < kCount; ++i) {
    const double x = rng.Normal();
    sum += x;
    squares += x * x;
  }
  EXPECT_NEAR(sum / kCount, 0, 0.03);
  EXPECT_NEAR(squares / kCount, 1, 0.05);
}

TEST(PlaneMapTest, TheInverseMapUndoesTheForwardMapOfABentPlane) {
  Rng rng(5);
  const cv::Matx33d tilt(1.1, 0.2, 60, -0.1, 0.9, 40, 4e-4, -3e-4, 1);
  for (int i = 0; i < 20; ++i) {
    const PlaneMap map(tilt, ElasticWaves::Random(rng, 0.45, 50), 3);
    const cv::Point2d plane(rng.Uniform(-60, 60), rng.Uniform(-60, 60));
    EXPECT_LT(cv::norm(map.PlaneFromImage(map.ImageFromPlane(plane)) - plane), 2e-3);
  }
}

TEST(MotionTest, AMotionWithoutCurvesIsAShiftToItsHome) {
  Motion motion;
  motion.home = {3, -4};
  EXPECT_EQ(cv::norm(motion.At(7) - cv::Matx33d(1, 0, 3, 0, 1, -4, 0, 0, 1)), 0);
}

TEST(MotionTest, ThePivotComesToTheHomeHoweverTheMotionTurnsAndScales) {
  Motion motion;
  motion.home = {30, 20};
  motion.pivot = {-7, 2};
  motion.angle = Curve({0, 2}, 10);
  motion.log_scale = Curve({0, 1}, 10);
  const PlaneMap map(motion.At(6), ElasticWaves(), 6);
  EXPECT_LT(cv::norm(map.ImageFromPlane(motion.pivot) - motion.home), 1e-9);
}

TEST(MotionTest, AChildIsCarriedByItsParent) {
  Motion parent, child;
  parent.home = {10, 0};
  parent.angle = Curve({0, 1.5}, 10);
  child.home = {5, 0};
  child.angle = Curve({0, -0.5}, 10);
  const cv::Matx33d alone = child.At(4);
  child.parent = std::make_shared<const Motion>(parent);
  EXPECT_LT(cv::norm(child.At(4) - parent.At(4) * alone), 1e-12);
}

TEST(MotionTest, ARestingMotionStandsStillAndMakesUpForIt) {
  Motion motion, resting;
  motion.x = resting.x = Curve({0, 30}, 20);
  resting.rest = {5, 15, 20};
  EXPECT_EQ(cv::norm(resting.At(5) - resting.At(15)), 0);
  EXPECT_EQ(cv::norm(resting.At(5) - resting.At(9.5)), 0);
  EXPECT_DOUBLE_EQ(resting.At(2)(0, 2), motion.At(4)(0, 2));
  EXPECT_DOUBLE_EQ(resting.At(20)(0, 2), motion.At(20)(0, 2));
}

TEST(CurveTest, ASwingStaysWithinItsAmplitudeAndComesBackAfterItsPeriod) {
  const Curve curve = Curve::Swing(1, 0.5, 8, 0.3, 24);
  for (const double time : {0.0, 3.0, 11.0}) {
    EXPECT_NEAR(curve.At(time), curve.At(time + 8), 1e-9);
    EXPECT_LE(std::abs(curve.At(time) - 1), 0.5);
  }
}

}  // namespace
}  // namespace holdfast
