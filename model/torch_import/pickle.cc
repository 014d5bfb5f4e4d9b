// SPDX-License-Identifier: Apache-2.0
#include "model/torch_import/pickle.h"

#include <cstring>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "io/quoted.h"
#include "model/torch_import/pickle_stack.h"
#include "model/torch_import/torch_pickle.h"

namespace holdfast {
namespace {

using Kind = PickleValue::Kind;

constexpr size_t kMaxBytes = size_t{8} << 20;
constexpr size_t kMaxValues = size_t{1} << 20;

// For messages.
// The stack machine. Each operation returns false after Fail() said why.
class Machine {
 public:
  explicit Machine(absl::string_view bytes) : bytes_(bytes) {}

  absl::StatusOr<std::unique_ptr<PickleDocument>> Run() {
    while (document_->root == nullptr) {
      if (!Step()) {
        return absl::InvalidArgumentError(absl::StrCat("pickle, before byte ", bytes_.position(), ": ", problem_));
      }
    }
    return std::move(document_);
  }

 private:
  using Operation = bool (Machine::*)();
  static Operation Find(unsigned char opcode);

  bool Step() {
    if (document_->values.size() > kMaxValues) return Fail(absl::StrCat("more than ", kMaxValues, " values"));
    uint64_t opcode = 0;
    if (!TakeNumber(1, opcode)) return false;
    const Operation operation = Find(static_cast<unsigned char>(opcode));
    if (operation == nullptr) return Fail(absl::StrCat("opcode 0x", absl::Hex(opcode), " is not supported"));
    return (this->*operation)();
  }

  bool Fail(std::string problem) {
    problem_ = std::move(problem);
    return false;
  }

  bool Take(size_t count, absl::string_view& taken) { return bytes_.Take(count, taken) || Fail("truncated"); }
  bool TakeNumber(size_t count, uint64_t& number) { return bytes_.TakeNumber(count, number) || Fail("truncated"); }
  bool TakeLine(absl::string_view& line) { return bytes_.TakeLine(line) || Fail("truncated"); }

  bool Pop(PickleValue*& value) { return stack_.Pop(value) || Fail("the stack is empty"); }
  bool Top(PickleValue*& value) { return stack_.Top(value) || Fail("the stack is empty"); }
  bool PopToMark(std::vector<const PickleValue*>& items) {
    return stack_.PopToMark(items) || Fail("no mark on the stack");
  }

  PickleValue* New(Kind kind) {
    document_->values.emplace_back();
    document_->values.back().kind = kind;
    return &document_->values.back();
  }

  bool Push(PickleValue* value) {
    stack_.Push(value);
    return true;
  }

  bool PushInteger(int64_t integer) {
    PickleValue* value = New(Kind::kInteger);
    value->integer = integer;
    return Push(value);
  }

  // Operations: plain values ------------------------------------------------------------------------------------------

  bool Protocol() {
    uint64_t version = 0;
    if (!TakeNumber(1, version)) return false;
    return version <= 3 || Fail(absl::StrCat("protocol ", version, "; torch.save writes 2"));
  }
  bool None() { return Push(New(Kind::kOther)); }
  bool True() { return PushInteger(1); }
  bool False() { return PushInteger(0); }
  bool Float() {
    absl::string_view ignored;
    return Take(8, ignored) && None();
  }
  bool Int1() {
    uint64_t n = 0;
    return TakeNumber(1, n) && PushInteger(static_cast<int64_t>(n));
  }
  bool Int2() {
    uint64_t n = 0;
    return TakeNumber(2, n) && PushInteger(static_cast<int64_t>(n));
  }
  bool Int4() {
    uint64_t n = 0;
    return TakeNumber(4, n) && PushInteger(static_cast<int32_t>(n));
  }
  // A two's complement number of up to 255 bytes; one that 64 bits cannot hold is nothing a tensor needs.
  bool Long() {
    uint64_t count = 0;
    absl::string_view digits;
    if (!TakeNumber(1, count) || !Take(count, digits)) return false;
    if (count > 8) return None();
    uint64_t n = count > 0 && (digits.back() & 0x80) != 0 ? ~uint64_t{0} : 0;
    std::memcpy(&n, digits.data(), count);
    return PushInteger(static_cast<int64_t>(n));
  }
  bool Text(size_t length_bytes) {
    uint64_t count = 0;
    absl::string_view text;
    if (!TakeNumber(length_bytes, count) || !Take(count, text)) return false;
    PickleValue* value = New(Kind::kText);
    value->text = std::string(text);
    return Push(value);
  }
  bool LongText() { return Text(4); }
  bool ShortText() { return Text(1); }

  // Operations: containers --------------------------------------------------------------------------------------------

  bool Mark() {
    stack_.Mark();
    return true;
  }
  bool EmptyTuple() { return Push(New(Kind::kTuple)); }
  bool EmptyList() { return Push(New(Kind::kList)); }
  bool EmptyDict() { return Push(New(Kind::kDict)); }
  bool MarkedTuple() {
    PickleValue* tuple = New(Kind::kTuple);
    return PopToMark(tuple->items) && Push(tuple);
  }
  bool SmallTuple(size_t count) {
    PickleValue* tuple = New(Kind::kTuple);
    return stack_.PopMany(count, tuple->items) ? Push(tuple) : Fail("the stack is empty");
  }
  bool Tuple1() { return SmallTuple(1); }
  bool Tuple2() { return SmallTuple(2); }
  bool Tuple3() { return SmallTuple(3); }

  // Adds 'items' to the container on top of the stack; what an inert object is given is dropped.
  bool Extend(Kind kind, const std::vector<const PickleValue*>& items) {
    PickleValue* container = nullptr;
    if (!Top(container)) return false;
    if (container->kind == Kind::kOther) return true;
    if (container->kind != kind) return Fail("items for a value that is not their container");
    if (kind == Kind::kDict && items.size() % 2 != 0) return Fail("a dict key without a value");
    container->items.insert(container->items.end(), items.begin(), items.end());
    return true;
  }
  bool Append() {
    PickleValue* item = nullptr;
    return Pop(item) && Extend(Kind::kList, {item});
  }
  bool Appends() {
    std::vector<const PickleValue*> items;
    return PopToMark(items) && Extend(Kind::kList, items);
  }
  bool SetItem() {
    PickleValue* key = nullptr;
    PickleValue* value = nullptr;
    return Pop(value) && Pop(key) && Extend(Kind::kDict, {key, value});
  }
  bool SetItems() {
    std::vector<const PickleValue*> items;
    return PopToMark(items) && Extend(Kind::kDict, items);
  }
  bool Drop() { return stack_.Drop() || Fail("the stack is empty"); }

  // Operations: memo --------------------------------------------------------------------------------------------------

  bool Put(size_t index_bytes) {
    uint64_t index = 0;
    PickleValue* value = nullptr;
    if (!TakeNumber(index_bytes, index) || !Top(value)) return false;
    memo_[index] = value;
    return true;
  }
  bool Get(size_t index_bytes) {
    uint64_t index = 0;
    if (!TakeNumber(index_bytes, index)) return false;
    const auto found = memo_.find(index);
    if (found == memo_.end()) return Fail(absl::StrCat("memo ", index, " was never put"));
    return Push(found->second);
  }
  bool Put1() { return Put(1); }
  bool Put4() { return Put(4); }
  bool Get1() { return Get(1); }
  bool Get4() { return Get(4); }

  // Operations: names and calls ---------------------------------------------------------------------------------------

  bool Global() {
    absl::string_view module, name;
    if (!TakeLine(module) || !TakeLine(name)) return false;
    PickleValue* global = New(Kind::kGlobal);
    global->text = absl::StrCat(module, " ", name);
    if (ClassifyPickleGlobal(global->text) == PickleGlobal::kRefused) {
      return Fail(absl::StrCat("refers to ", Quoted(absl::StrCat(module, ".", name)), ", which no state dict needs"));
    }
    return Push(global);
  }

  bool PersistentId() {
    PickleValue* id = nullptr;
    if (!Pop(id)) return false;
    if (!IsStorageId(*id)) return Fail("a persistent id that is no storage");
    PickleValue* storage = New(Kind::kStorage);
    storage->dtype = *PickleStorageType(id->items[1]->text);
    storage->text = id->items[2]->text;
    storage->integer = id->items[4]->integer;
    return Push(storage);
  }

  bool RebuildTensor(const std::vector<const PickleValue*>& arguments) {
    if (!IsTensorCall(arguments)) return Fail("a tensor that is not storage, offset, sizes and strides");
    PickleValue* tensor = New(Kind::kTensor);
    tensor->items.assign(arguments.begin(), arguments.begin() + 4);
    return Push(tensor);
  }

  // (tensor, requires_grad, hooks)
  bool RebuildParameter(const std::vector<const PickleValue*>& arguments) {
    if (arguments.empty() || arguments[0]->kind != Kind::kTensor) return Fail("a parameter that is no tensor");
    PickleValue* tensor = New(Kind::kTensor);
    tensor->items = arguments[0]->items;
    return Push(tensor);
  }

  bool Reduce() {
    PickleValue* arguments = nullptr;
    PickleValue* callable = nullptr;
    if (!Pop(arguments) || !Pop(callable)) return false;
    if (arguments->kind != Kind::kTuple || callable->kind != Kind::kGlobal) return Fail("a call of no function");
    switch (ClassifyPickleGlobal(callable->text)) {
      case PickleGlobal::kRebuildTensor:
        return RebuildTensor(arguments->items);
      case PickleGlobal::kRebuildParameter:
        return RebuildParameter(arguments->items);
      case PickleGlobal::kOrderedDict:
        return arguments->items.empty() ? EmptyDict() : Fail("an OrderedDict made of arguments");
      case PickleGlobal::kInert:
        return None();
      default:
        return Fail(absl::StrCat("a call of ", Quoted(callable->text)));
    }
  }

  bool NewObject() {
    PickleValue* ignored = nullptr;
    return Pop(ignored) && Pop(ignored) && None();
  }

  // The attributes of an object (a state dict's versions, an optimizer's settings) carry no tensor we need.
  bool Build() {
    PickleValue* state = nullptr;
    PickleValue* object = nullptr;
    return Pop(state) && Top(object);
  }

  bool Stop() {
    PickleValue* root = nullptr;
    if (!Pop(root)) return false;
    document_->root = root;
    return true;
  }

  PickleBytes bytes_;
  std::unique_ptr<PickleDocument> document_ = std::make_unique<PickleDocument>();
  PickleStack stack_;
  std::unordered_map<uint64_t, PickleValue*> memo_;
  std::string problem_;
};

Machine::Operation Machine::Find(unsigned char opcode) {
  struct Row {
    unsigned char opcode;
    Operation operation;
  };
  static constexpr Row kRows[] = {
      {0x80, &Machine::Protocol},    {'N', &Machine::None},        {0x88, &Machine::True},
      {0x89, &Machine::False},       {'G', &Machine::Float},       {'K', &Machine::Int1},
      {'M', &Machine::Int2},         {'J', &Machine::Int4},        {0x8a, &Machine::Long},
      {'X', &Machine::LongText},     {'T', &Machine::LongText},    {'U', &Machine::ShortText},
      {'(', &Machine::Mark},         {')', &Machine::EmptyTuple},  {']', &Machine::EmptyList},
      {'}', &Machine::EmptyDict},    {'t', &Machine::MarkedTuple}, {0x85, &Machine::Tuple1},
      {0x86, &Machine::Tuple2},      {0x87, &Machine::Tuple3},     {'a', &Machine::Append},
      {'e', &Machine::Appends},      {'s', &Machine::SetItem},     {'u', &Machine::SetItems},
      {'0', &Machine::Drop},         {'q', &Machine::Put1},        {'r', &Machine::Put4},
      {'h', &Machine::Get1},         {'j', &Machine::Get4},        {'c', &Machine::Global},
      {'Q', &Machine::PersistentId}, {'R', &Machine::Reduce},      {0x81, &Machine::NewObject},
      {'b', &Machine::Build},        {'.', &Machine::Stop},
  };
  for (const Row& row : kRows) {
    if (row.opcode == opcode) return row.operation;
  }
  return nullptr;
}

}  // namespace

absl::StatusOr<std::unique_ptr<PickleDocument>> ReadPickle(absl::string_view bytes) {
  if (bytes.size() > kMaxBytes) {
    return absl::InvalidArgumentError(absl::StrCat("pickle of ", bytes.size(), " bytes; at most ", kMaxBytes));
  }
  return Machine(bytes).Run();
}

}  // namespace holdfast
