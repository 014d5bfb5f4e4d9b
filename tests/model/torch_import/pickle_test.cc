// SPDX-License-Identifier: Apache-2.0
#include "model/torch_import/pickle.h"

#include <gmock/gmock.h>

#include <random>

#include "tests/model/torch_import/pickle_builder.h"
#include "tests/support/mutate.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using Kind = PickleValue::Kind;

TEST(PickleTest, PlainValuesAreRead) {
  const std::string bytes =
      PickleBuilder().Raw("(").Int(-5).Raw("K\xffM\x01\x02\x88").Text("text").Raw("U\x02hiNG12345678]t").Stop();
  const auto document = ReadPickle(bytes);
  ASSERT_THAT(document, IsOk());
  const auto& items = (*document)->root->items;
  ASSERT_EQ((*document)->root->kind, Kind::kTuple);
  ASSERT_EQ(items.size(), 9);
  EXPECT_EQ(items[0]->integer, -5);
  EXPECT_EQ(items[1]->integer, 255);
  EXPECT_EQ(items[2]->integer, 513);
  EXPECT_EQ(items[3]->integer, 1);
  EXPECT_EQ(items[4]->text, "text");
  EXPECT_EQ(items[5]->text, "hi");
  EXPECT_EQ(items[6]->kind, Kind::kOther);
  EXPECT_EQ(items[7]->kind, Kind::kOther);
  EXPECT_EQ(items[8]->kind, Kind::kList);
}

TEST(PickleTest, LongIntegersKeepTheirSign) {
  const std::string short_numbers("\x8a\1\xff\x8a\2\0\x80\x8a\0", 9);  // -1, -2^15 and 0 in as few bytes as they take
  const auto sound = ReadPickle(PickleBuilder().Raw("(").Raw(short_numbers).Long(int64_t{1} << 40).Raw("t").Stop());
  ASSERT_THAT(sound, IsOk());
  EXPECT_EQ((*sound)->root->items[0]->integer, -1);
  EXPECT_EQ((*sound)->root->items[1]->integer, -32768);
  EXPECT_EQ((*sound)->root->items[2]->integer, 0);
  EXPECT_EQ((*sound)->root->items[3]->integer, int64_t{1} << 40);
}

TEST(PickleTest, ContainersAndTheMemoWork) {
  const auto document = ReadPickle(PickleBuilder()
                                       .Raw("}q")
                                       .Raw(std::string(1, '\0'))
                                       .Raw("(")
                                       .Text("a")
                                       .Raw("](K\1K\2eK\3a")
                                       .Text("b")
                                       .Raw("K\7q\1u")
                                       .Text("c")
                                       .Raw("h\1s")
                                       .Stop());
  ASSERT_THAT(document, IsOk());
  const auto& dict = *(*document)->root;
  ASSERT_EQ(dict.kind, Kind::kDict);
  ASSERT_EQ(dict.items.size(), 6);
  EXPECT_EQ(dict.items[1]->items.size(), 3);
  EXPECT_EQ(dict.items[3]->integer, 7);
  EXPECT_EQ(dict.items[5], dict.items[3]);
}

TEST(PickleTest, ATensorNamesItsStorage) {
  const auto document = ReadPickle(PickleBuilder().Tensor("17", 10, 2, 3, 1).Stop());
  ASSERT_THAT(document, IsOk());
  const auto& tensor = *(*document)->root;
  ASSERT_EQ(tensor.kind, Kind::kTensor);
  EXPECT_EQ(tensor.items[0]->text, "17");
  EXPECT_EQ(tensor.items[0]->integer, 10);
  EXPECT_EQ(tensor.items[0]->dtype, torch::kFloat32);
  EXPECT_EQ(tensor.items[1]->integer, 2);
  EXPECT_EQ(tensor.items[2]->items[0]->integer, 3);
}

TEST(PickleTest, AParameterIsItsTensor) {
  const auto document = ReadPickle(PickleBuilder()
                                       .Global("torch._utils", "_rebuild_parameter")
                                       .Raw("(")
                                       .Tensor("0", 1, 0, 1, 1)
                                       .Raw("\x88)tR")
                                       .Stop());
  ASSERT_THAT(document, IsOk());
  EXPECT_EQ((*document)->root->kind, Kind::kTensor);
}

TEST(PickleTest, AnythingThatCouldRunCodeIsRefusedByName) {
  EXPECT_THAT(ReadPickle(PickleBuilder().Global("os", "system").Raw("(").Text("id").Raw("tR").Stop()),
              StatusIs(kInvalid, HasSubstr("'os.system'")));
  for (const auto& [module, name] :
       std::vector<std::pair<std::string, std::string>>{{"posix", "system"},
                                                        {"builtins", "eval"},
                                                        {"__builtin__", "exec"},
                                                        {"subprocess", "Popen"},
                                                        {"torch", "load"},
                                                        {"torch.hub", "load"},
                                                        {"torch._utils", "_rebuild_tensor_v2x"},
                                                        {"numpy.core.multiarray", "scalar"},
                                                        {"", ""}}) {
    EXPECT_THAT(ReadPickle(PickleBuilder().Global(module, name).Stop()),
                StatusIs(kInvalid, HasSubstr("'" + module + "." + name + "'")));
  }
}

TEST(PickleTest, CallsOfSchedulerStatesAreKeptInertAndNeverMade) {
  const auto document = ReadPickle(PickleBuilder()
                                       .Global("__builtin__", "getattr")
                                       .Global("torch.optim.adamw", "AdamW")
                                       .Raw(")\x81}(")
                                       .Text("lr")
                                       .Raw("K\1ub")
                                       .Text("step")
                                       .Raw("\x86R")
                                       .Stop());
  ASSERT_THAT(document, IsOk());
  EXPECT_EQ((*document)->root->kind, Kind::kOther);
  // The value of such a call cannot be called in its turn.
  EXPECT_THAT(ReadPickle(PickleBuilder().Global("__builtin__", "getattr").Raw(")R)R").Stop()),
              StatusIs(kInvalid, HasSubstr("call of no function")));
}

struct Hostile {
  const char* name;
  std::string bytes;
  const char* message;
};

class HostilePickleTest : public ::testing::TestWithParam<Hostile> {};

TEST_P(HostilePickleTest, IsRefusedWithAClearMessage) {
  EXPECT_THAT(ReadPickle(GetParam().bytes), StatusIs(kInvalid, HasSubstr(GetParam().message)));
}

PickleBuilder TensorCall() { return PickleBuilder().Global("torch._utils", "_rebuild_tensor_v2"); }

INSTANTIATE_TEST_SUITE_P(
    Pickle, HostilePickleTest,
    ::testing::Values(
        Hostile{"Empty", "", "truncated"}, Hostile{"NoStop", "\x80\x02}", "truncated"},
        Hostile{"NewProtocol", "\x80\x05}.", "protocol 5"},
        Hostile{"StopOnEmptyStack", PickleBuilder().Stop(), "empty"},
        Hostile{"TextPastTheEnd",
                "X\xff\xff\xff\xff"
                "abc",
                "truncated"},
        Hostile{"GlobalWithoutEnd", "cos\nsystem", "truncated"},
        Hostile{"UnknownOpcode", PickleBuilder().Raw("\x93").Stop(), "opcode 0x93 is not supported"},
        Hostile{"InstanceOpcode", PickleBuilder().Raw("(ios\nsystem\n").Stop(), "opcode 0x69"},
        Hostile{"TupleOfTooFew", PickleBuilder().Raw("N\x87").Stop(), "the stack is empty"},
        Hostile{"TupleAcrossAMark", PickleBuilder().Raw("N(N\x86").Stop(), "the stack is empty"},
        Hostile{"TupleWithoutMark", PickleBuilder().Raw("Nt").Stop(), "no mark"},
        Hostile{"PopOfNothing", PickleBuilder().Raw("0").Stop(), "the stack is empty"},
        Hostile{"ReduceOfOne", PickleBuilder().Raw(")R").Stop(), "the stack is empty"},
        Hostile{"ReduceOfANumber", PickleBuilder().Raw("K\1)R").Stop(), "call of no function"},
        Hostile{"BuildOfOne", PickleBuilder().Raw("}b").Stop(), "the stack is empty"},
        Hostile{"CallOfAStorageType", PickleBuilder().Global("torch", "FloatStorage").Raw(")R").Stop(),
                "call of 'torch FloatStorage'"},
        Hostile{"HugeMemoIndexNotPut", PickleBuilder().Raw("j\xff\xff\xff\xff").Stop(),
                "memo 4294967295 was never put"},
        Hostile{"MemoOfEmptyStack", PickleBuilder().Raw("r\xff\xff\xff\xff").Stop(), "the stack is empty"},
        Hostile{"AppendToNumber", PickleBuilder().Raw("K\1K\1a").Stop(), "not their container"},
        Hostile{"ItemsForList", PickleBuilder().Raw("]K\1K\1s").Stop(), "not their container"},
        Hostile{"KeyWithoutValue", PickleBuilder().Raw("}(K\1u").Stop(), "key without a value"},
        Hostile{"OrderedDictOfArguments", PickleBuilder().Global("collections", "OrderedDict").Raw("]\x85R").Stop(),
                "OrderedDict made of arguments"},
        Hostile{"PersistentText", PickleBuilder().Text("storage").Raw("Q").Stop(), "no storage"},
        Hostile{
            "StorageOfNoType",
            PickleBuilder().Raw("(").Text("storage").Global("torch", "Size").Text("0").Text("cpu").Raw("K\1tQ").Stop(),
            "no storage"},
        Hostile{"StorageOfALongKey", PickleBuilder().Storage("FloatStorage", std::string(1000, '1'), 1).Stop(),
                "no storage"},
        Hostile{"TensorOfNothing", TensorCall().Raw(")R").Stop(), "storage, offset, sizes and strides"},
        Hostile{"TensorWithoutStorage", TensorCall().Raw("(NK\1))tR").Stop(), "storage, offset, sizes and strides"},
        Hostile{"TensorOfUnlikeSizes",
                TensorCall().Raw("(").Storage("FloatStorage", "0", 1).Int(0).Raw("K\1\x85)tR").Stop(),
                "storage, offset, sizes and strides"},
        Hostile{"TensorOfTextSizes",
                TensorCall().Raw("(").Storage("FloatStorage", "0", 1).Int(0).Text("1").Raw("\x85K\1\x85tR").Stop(),
                "storage, offset, sizes and strides"},
        Hostile{"ParameterOfNoTensor",
                PickleBuilder().Global("torch._utils", "_rebuild_parameter").Raw("N\x85R").Stop(), "no tensor"}),
    [](const auto& info) { return std::string(info.param.name); });

TEST(PickleTest, AHugeMemoIndexTakesNoMemory) {
  EXPECT_THAT(ReadPickle(PickleBuilder()
                             .Raw("}r\xff\xff\xff\xff"
                                  "0j\xff\xff\xff\xff")
                             .Stop()),
              IsOk());
}

TEST(PickleTest, AListWithinItselfIsReadAndFreed) {
  const auto document = ReadPickle(PickleBuilder().Raw("]q\1h\1a").Stop());
  ASSERT_THAT(document, IsOk());
  EXPECT_EQ((*document)->root->items[0], (*document)->root);
}

TEST(PickleTest, DeepNestingNeedsNoDeepStack) {
  std::string nested;
  for (int i = 0; i < 200000; ++i) nested += ")\x85";
  EXPECT_THAT(ReadPickle(PickleBuilder().Raw(nested).Stop()), IsOk());
}

TEST(PickleTest, MemoryIsBounded) {
  EXPECT_THAT(ReadPickle(std::string(9 << 20, '}')), StatusIs(kInvalid, HasSubstr("at most 8388608")));
  EXPECT_THAT(ReadPickle(std::string(2 << 20, '}')), StatusIs(kInvalid, HasSubstr("more than 1048576 values")));
}

TEST(PickleTest, ControlCharactersDoNotReachTheMessage) {
  EXPECT_THAT(ReadPickle(PickleBuilder().Global("os\x1b[31m", "system").Stop()),
              StatusIs(kInvalid, HasSubstr(R"('os\x1b[31m.system')")));
}

TEST(PickleFuzzTest, NoCorruptedPickleDoesHarm) {
  const std::string sound = PickleBuilder()
                                .Raw("}(")
                                .Text("optimizer")
                                .Raw("}(")
                                .Text("lr")
                                .Raw("G12345678")
                                .Text("betas")
                                .Raw("](K\1K\2eu")
                                .Text("model_state_dict")
                                .Global("collections", "OrderedDict")
                                .Raw(")Rq\1(")
                                .Text("w")
                                .Tensor("0", 8, 0, 8, 1)
                                .Text("b")
                                .Tensor("1", 4, 2, 2, 1)
                                .Raw("u}")
                                .Text("_metadata")
                                .Raw("Nsbu")
                                .Stop();
  ASSERT_THAT(ReadPickle(sound), IsOk());
  std::mt19937 random(7);
  int refused = 0;
  constexpr int kFiles = 30000;
  for (int i = 0; i < kFiles; ++i) {
    const auto document = ReadPickle(Mutate(sound, sound.size(), random));
    if (document.ok()) continue;
    ++refused;
    ASSERT_THAT(document, StatusIs(kInvalid)) << "mutation " << i;
  }
  RecordProperty("refused", refused);
  EXPECT_GT(refused, kFiles / 2);
  EXPECT_LT(refused, kFiles);
}

}  // namespace
}  // namespace holdfast
