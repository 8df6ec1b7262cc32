// Loads and ticks behaviour trees with BehaviorTree.CPP, as lines on stdin say; the answers are lines on stdout.
//
//   node KIND ID          register a node; its ports follow
//   port DIR NAME TYPE    a port of the last node; TYPE is a C++ type of <TreeNodesModel>
//   load FILE             make the tree of that file: `loaded`, or `refused: why`; forgets the nodes afterwards
//   file FILE             a file of the next `make`
//   make ID               make that tree of these files, as `load`; nodes of the library's own stay its own
//   set KEY TYPE VALUE    write to the root's blackboard; TYPE is double or string
//   halt                  halt the tree
//   tick LETTERS          one tick; the leaves answer S, F, R, K by name: `A=S B=R`
//   ticks LETTERS         one tick; the leaves answer by their number, in the order of their creation: `SFR`
//
// `tick`, `ticks` and `halt` are answered by what the leaves did, `->`, and the root's status.

#include <behaviortree_cpp/bt_factory.h>

#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

using BT::NodeStatus;

static std::vector<std::string> trace;
static std::map<std::string, std::vector<char>> answers;
static std::string by_number;

static NodeStatus status_of(char letter)
{
  switch(letter)
  {
    case 'S': return NodeStatus::SUCCESS;
    case 'F': return NodeStatus::FAILURE;
    case 'K': return NodeStatus::SKIPPED;
    default: return NodeStatus::RUNNING;
  }
}

class Leaf : public BT::ActionNodeBase
{
public:
  using BT::ActionNodeBase::ActionNodeBase;
  std::size_t number = 0;
  int ticked = 0;
  NodeStatus tick() override
  {
    if(!by_number.empty())
    {
      // A loop without end in one tick is interrupted.
      const char given = ++ticked > 9 ? 'R' : by_number[number % by_number.size()];
      trace.push_back(std::to_string(number) + ":" + given);
      return status_of(given);
    }
    auto& mine = answers[name()];
    const char letter = mine.empty() ? '?' : mine.front();
    if(!mine.empty())
    {
      mine.erase(mine.begin());
    }
    trace.push_back(name() + ":" + letter);
    return status_of(letter);
  }
  void halt() override
  {
    if(status() == NodeStatus::RUNNING)
    {
      trace.push_back("halt " + (by_number.empty() ? name() : std::to_string(number)));
    }
    resetStatus();
  }
};

class Flow : public BT::ControlNode
{
public:
  using BT::ControlNode::ControlNode;
  NodeStatus tick() override { return NodeStatus::FAILURE; }
};

class Wrapper : public BT::DecoratorNode
{
public:
  using BT::DecoratorNode::DecoratorNode;
  NodeStatus tick() override { return NodeStatus::FAILURE; }
};

static std::pair<std::string, BT::PortInfo> port(BT::PortDirection way, const std::string& name,
                                                 const std::string& type)
{
  using Strings = std::vector<std::string>;
  if(type == "int") { return BT::CreatePort<int>(way, name); }
  if(type == "unsigned") { return BT::CreatePort<unsigned>(way, name); }
  if(type == "double") { return BT::CreatePort<double>(way, name); }
  if(type == "bool") { return BT::CreatePort<bool>(way, name); }
  if(type == "std::string" || type == "ObjectId") { return BT::CreatePort<std::string>(way, name); }
  if(type == "std::vector<int>") { return BT::CreatePort<std::vector<int>>(way, name); }
  if(type == "std::vector<double>") { return BT::CreatePort<std::vector<double>>(way, name); }
  if(type == "std::vector<bool>") { return BT::CreatePort<std::vector<bool>>(way, name); }
  if(type == "std::vector<std::string>" || type == "std::vector<ObjectId>")
  {
    return BT::CreatePort<Strings>(way, name);
  }
  if(type == "BT::AnyTypeAllowed") { return BT::CreatePort<BT::AnyTypeAllowed>(way, name); }
  throw std::runtime_error("the driver knows no type " + type);
}

struct Sleeper : BT::TreeNode
{
  static constexpr auto wake_up = &Sleeper::setWakeUpInstance;
};

static std::string one_line(std::string text)
{
  for(auto& letter : text)
  {
    letter = letter == '\n' || letter == '\r' ? ' ' : letter;
  }
  return text;
}

template <typename T>
static void add(BT::BehaviorTreeFactory& factory, const BT::TreeNodeManifest& manifest)
{
  factory.registerBuilder(manifest, [](const std::string& name, const BT::NodeConfig& config) {
    return std::make_unique<T>(name, config);
  });
}

static void answer(const BT::Tree& tree)
{
  // A root that is skipped keeps the status IDLE in BehaviorTree.CPP: the caller has what the tick returned.
  (void)tree;
  for(const auto& word : trace)
  {
    std::cout << word << " ";
  }
  trace.clear();
}

int main()
{
  std::vector<BT::TreeNodeManifest> manifests;
  std::vector<std::string> files;
  auto factory = std::make_unique<BT::BehaviorTreeFactory>();
  BT::Tree tree;
  auto* const shown = std::cout.rdbuf();
  std::ostringstream hidden;
  for(std::string line; std::getline(std::cin, line);)
  {
    std::istringstream words(line);
    std::string word, first, second, rest;
    words >> word;
    try
    {
      if(word == "node")
      {
        words >> first >> std::ws;
        std::getline(words, second);
        manifests.push_back({ BT::convertFromString<BT::NodeType>(first), second, {}, {} });
      }
      else if(word == "port")
      {
        words >> first >> second >> std::ws;
        std::getline(words, rest);
        const auto way = first == "input_port"  ? BT::PortDirection::INPUT :
                         first == "output_port" ? BT::PortDirection::OUTPUT :
                                                  BT::PortDirection::INOUT;
        manifests.back().ports.insert(port(way, second, rest));
      }
      else if(word == "file")
      {
        words >> std::ws;
        std::getline(words, rest);
        files.push_back(rest);
      }
      else if(word == "load" || word == "make")
      {
        words >> std::ws;
        std::getline(words, rest);
        const auto parts = word == "load" ? std::vector<std::string>{ rest } : std::move(files);
        files.clear();
        tree = BT::Tree();
        factory = std::make_unique<BT::BehaviorTreeFactory>();
        auto nodes = std::move(manifests);
        manifests.clear();
        std::cout.rdbuf(hidden.rdbuf());  // the library lists its blackboard before it refuses
        for(const auto& manifest : nodes)
        {
          if(word == "make" && factory->manifests().count(manifest.registration_ID) != 0)
          {
            continue;
          }
          switch(manifest.type)
          {
            case BT::NodeType::CONTROL: add<Flow>(*factory, manifest); break;
            case BT::NodeType::DECORATOR: add<Wrapper>(*factory, manifest); break;
            default: add<Leaf>(*factory, manifest);
          }
        }
        for(const auto& part : parts)
        {
          factory->registerBehaviorTreeFromFile(part);
        }
        const auto names = factory->registeredBehaviorTrees();
        const std::string first_tree = word == "make" ? rest : "Main";
        const bool main = std::find(names.begin(), names.end(), first_tree) != names.end();
        for(const auto& name : main ? std::vector<std::string>{ first_tree } : names)
        {
          tree = factory->createTree(name);
        }
        // Without a signal to wake up, SequenceWithMemory does not end the tick between two children.
        std::size_t count = 0;
        tree.applyVisitor([&count](BT::TreeNode* node) {
          (node->*Sleeper::wake_up)(nullptr);
          if(auto* const leaf = dynamic_cast<Leaf*>(node))
          {
            leaf->number = count++;
          }
        });
        std::cout.rdbuf(shown);
        std::cout << "loaded" << std::endl;
      }
      else if(word == "set")
      {
        words >> first >> second >> std::ws;
        std::getline(words, rest);
        if(second == "double")
        {
          tree.rootBlackboard()->set(first, std::stod(rest));
        }
        else
        {
          tree.rootBlackboard()->set(first, rest);
        }
      }
      else if(word == "halt")
      {
        tree.haltTree();
        answer(tree);
        std::cout << "-> " << BT::toStr(tree.rootNode()->status()) << std::endl;
      }
      else if(word == "tick")
      {
        answers.clear();
        by_number.clear();
        for(std::string given; words >> given;)
        {
          answers[given.substr(0, given.find('='))].push_back(given.back());
        }
        const auto status = tree.tickExactlyOnce();
        answer(tree);
        std::cout << "-> " << BT::toStr(status) << std::endl;
      }
      else if(word == "ticks")
      {
        words >> by_number;
        tree.applyVisitor([](BT::TreeNode* node) {
          if(auto* const leaf = dynamic_cast<Leaf*>(node))
          {
            leaf->ticked = 0;
          }
        });
        const auto status = tree.tickExactlyOnce();
        answer(tree);
        std::cout << "-> " << BT::toStr(status) << std::endl;
      }
    }
    catch(const std::exception& error)
    {
      std::cout.rdbuf(shown);
      trace.clear();
      files.clear();
      std::cout << (word == "load" || word == "make" ? "refused: " : "threw: ") << one_line(error.what()) << std::endl;
    }
  }
}
