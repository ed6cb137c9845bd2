#include "engine/io/pickles/pickle_machine.h"

#include "engine/io/pickles/pickle_objects.h"

namespace doppel::pickle {

namespace {

class Machine : Objects {
public:
    using Objects::Objects;

    size_t consumed() const { return position_; }

    uint32_t run() {
        while (true) {
            const uint8_t opcode = take(1)[0];
            if (opcode == '.') return pop();
            step(opcode);
        }
    }

private:
    void step(uint8_t opcode) {
        switch (opcode) {
            case 0x80: {  // PROTO
                const uint8_t protocol = take(1)[0];
                if (protocol > 5) bad("protocol {}; expected 0 to 5", protocol);
                return;
            }
            case 0x95: {  // FRAME
                if (takeLittle<uint64_t>() > bytes_.size() - position_) {
                    throwInput("{}: the pickle is cut short", file_);
                }
                return;
            }
            case '(':
                marks_.push_back(stack_.size());
                return;
            case '0':  // POP, of a mark as well
                if (!marks_.empty() && marks_.back() == stack_.size()) {
                    marks_.pop_back();
                } else {
                    pop();
                }
                return;
            case '1':
                popToMark();
                return;
            case '2':
                push(top());
                return;

            case 'N':
                push(add(Kind::none));
                return;
            case 0x88:
                pushInteger(1, Kind::boolean);
                return;
            case 0x89:
                pushInteger(0, Kind::boolean);
                return;
            case 'I': {
                const std::string_view line = takeLine();
                if (line == "00" || line == "01") {
                    pushInteger(line == "01", Kind::boolean);
                } else {
                    pushInteger(number<int64_t>(line));
                }
                return;
            }
            case 'L': {
                std::string_view line = takeLine();
                if (!line.empty() && line.back() == 'L') line.remove_suffix(1);
                pushInteger(number<int64_t>(line));
                return;
            }
            case 'J':
                pushInteger(takeLittle<int32_t>());
                return;
            case 'K':
                pushInteger(take(1)[0]);
                return;
            case 'M':
                pushInteger(takeLittle<uint16_t>());
                return;
            case 0x8a:
                pushLong(take(take(1)[0]));
                return;
            case 0x8b:
                pushLong(take(takeLittle<uint32_t>()));
                return;
            case 'F':
                pushReal(number<double>(takeLine()));
                return;
            case 'G': {
                uint64_t bits = 0;
                for (const uint8_t byte : take(8)) bits = bits << 8 | byte;
                double value;
                std::memcpy(&value, &bits, sizeof value);
                pushReal(value);
                return;
            }

            case 'S':
                pushText(Kind::bytes, unquote(takeLine()));
                return;
            case 'T':
                pushText(Kind::bytes, takeText(takeLittle<uint32_t>()));
                return;
            case 'U':
                pushText(Kind::bytes, takeText(take(1)[0]));
                return;
            case 'B':
                pushText(Kind::bytes, takeText(takeLittle<uint32_t>()));
                return;
            case 'C':
                pushText(Kind::bytes, takeText(take(1)[0]));
                return;
            case 0x8e:
                pushText(Kind::bytes, takeText(takeLittle<uint64_t>()));
                return;
            case 0x96:
                pushText(Kind::bytes, takeText(takeLittle<uint64_t>()));
                return;
            case 'V':
                pushText(Kind::text, rawUnicode(takeLine()));
                return;
            case 'X':
                pushText(Kind::text, takeText(takeLittle<uint32_t>()));
                return;
            case 0x8c:
                pushText(Kind::text, takeText(take(1)[0]));
                return;
            case 0x8d:
                pushText(Kind::text, takeText(takeLittle<uint64_t>()));
                return;

            case ')':
                push(add(Kind::tuple));
                return;
            case ']':
                push(add(Kind::list));
                return;
            case '}':
                push(add(Kind::dict));
                return;
            case 0x8f:
                push(add(Kind::set));
                return;
            case 't':
                pushItems(Kind::tuple, popToMark());
                return;
            case 'l':
                pushItems(Kind::list, popToMark());
                return;
            case 0x91:
                pushItems(Kind::set, popToMark());
                return;
            case 'd': {
                std::vector<uint32_t> items = popToMark();
                if (items.size() % 2 != 0) bad("a dict with half a pair");
                pushItems(Kind::dict, std::move(items));
                return;
            }
            case 0x85:
                pushTuple(1);
                return;
            case 0x86:
                pushTuple(2);
                return;
            case 0x87:
                pushTuple(3);
                return;
            case 'a': {
                const uint32_t item = pop();
                extend(Kind::list, {item});
                return;
            }
            case 'e': {
                std::vector<uint32_t> items = popToMark();
                extend(Kind::list, items);
                return;
            }
            case 0x90: {
                std::vector<uint32_t> items = popToMark();
                extend(Kind::set, items);
                return;
            }
            case 's': {
                const uint32_t value = pop(), key = pop();
                extend(Kind::dict, {key, value});
                return;
            }
            case 'u': {
                std::vector<uint32_t> items = popToMark();
                if (items.size() % 2 != 0) bad("a dict with half a pair");
                extend(Kind::dict, items);
                return;
            }

            case 'p':
                remember(number<uint32_t>(takeLine()));
                return;
            case 'q':
                remember(take(1)[0]);
                return;
            case 'r':
                remember(takeLittle<uint32_t>());
                return;
            case 0x94:
                remember(memo_.size());
                return;
            case 'g':
                recall(number<uint32_t>(takeLine()));
                return;
            case 'h':
                recall(take(1)[0]);
                return;
            case 'j':
                recall(takeLittle<uint32_t>());
                return;

            case 'c': {
                const std::string_view module = takeLine();
                pushName(module, takeLine());
                return;
            }
            case 0x93: {
                const uint32_t name = pop(), module = pop();
                pushName(textOf(module), textOf(name));
                return;
            }
            case 'R': {
                const uint32_t arguments = pop(), function = pop();
                push(call(nameOf(function), argumentsOf(arguments)));
                return;
            }
            case 0x92:
                pop();
                [[fallthrough]];  // NEWOBJ_EX: keyword arguments on top
            case 0x81: {
                const uint32_t arguments = pop(), type = pop();
                push(call(nameOf(type), argumentsOf(arguments)));
                return;
            }
            case 'i': {
                const std::string_view module = takeLine();
                const std::string_view name = takeLine();
                const std::vector<uint32_t> arguments = popToMark();
                pushName(module, name);
                push(call(nameOf(pop()), arguments));
                return;
            }
            case 'o': {
                std::vector<uint32_t> arguments = popToMark();
                if (arguments.empty()) bad("an object without a type");
                const uint32_t type = arguments.front();
                arguments.erase(arguments.begin());
                push(call(nameOf(type), arguments));
                return;
            }
            case 'b': {
                const uint32_t state = pop();
                build(top(), state);
                return;
            }
            case 'Q':
                if (torch_) {
                    push(torchStorage(pop()));
                    return;
                }
                [[fallthrough]];
            case 'P':
                throwInput("{}: refers to data outside the file (a persistent id)", file_);
            case 0x82:
            case 0x83:
            case 0x84:
                throwInput(
                    "{}: refers to code (by an extension's number); only numeric data is read",
                    file_);
            case 0x97:
            case 0x98:
                throwInput("{}: refers to buffers outside the file", file_);
            default:
                --position_;
                bad("the opcode 0x{:02x} is unknown", opcode);
        }
    }

    void extend(Kind kind, const std::vector<uint32_t>& items) {
        Node& target = nodes_[top()];
        if (target.kind != kind) bad("it adds to {}", kindName(target));
        target.items.insert(target.items.end(), items.begin(), items.end());
    }
};

}  // namespace

uint32_t run(std::span<const uint8_t> bytes, const std::string& name, PickleGraph& graph,
             bool torch, size_t& consumed) {
    Machine machine(bytes, name, graph, torch);
    const uint32_t root = machine.run();
    consumed = machine.consumed();
    return root;
}

}  // namespace doppel::pickle
